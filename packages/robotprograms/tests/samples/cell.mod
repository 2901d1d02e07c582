%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%
MODULE Cell
  PERS tooldata tMill:=[TRUE,[[0,0,215.5],[1,0,0,0]],[12.5,[0,0,100],[1,0,0,0],0,0,0]];
  PERS wobjdata wPart:=[FALSE,TRUE,"",[[1200,-300,800],[0.7071068,0,0,0.7071068]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget p10:=[[10,20.5,-3.25],[0.00000001,0.707106781,0.707106781,0],[0,-1,0,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]; ! first
  CONST robtarget p20:=[[11.123456,20.5,-3.25],
        [0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget jHome:=[[0,-10,20.5,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR num n:=0;

  PROC main()
    ConfL\Off;
    AccSet 50,50;
    MoveAbsJ jHome\NoEOffs,v200,fine,tMill;
    MoveJ p10,v200,z10,tMill\WObj:=wPart;
    MoveL p20,v20,fine,tMill\WObj:=wPart;
    MoveL [[12.5,20.5,-3.25],[0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],[20,500,5000,1000],z1,tMill\WObj:=wPart;
    MoveC [[13.5,21.5,-3.25],[0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],[[14.5,20.5,-3.25],[0,0.707106781,0.707106781,0],[0,-1,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]],v20,z1,tMill\WObj:=wPart;
    IF n=0 THEN
      SetDO doSpindle,1;
    ENDIF
    Retract;
    n:=n+1;
  ENDPROC

  PROC Retract()
    MoveL p10,v200,z10,tMill\WObj:=wPart;
  ENDPROC
ENDMODULE
