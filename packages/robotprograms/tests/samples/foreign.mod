MODULE M
CONST robtarget p10:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
PERS robtarget p20:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
! t1 is a tool of another module
PERS wobjdata w1:=[FALSE,TRUE,"",[[1,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
VAR intnum i1;
VAR num n:=1;
PROC main()
MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,z1,t1;
…
MoveL p20,v1,z1,t1;
MoveL p10,v1,z1,t1;
ENDPROC
§
ENDMODULE
